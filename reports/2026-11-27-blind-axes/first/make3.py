from machines2 import *

R='drive.'
for k in M2:
    p=M2[k]['p']; vel=p.get('MODE',0)==2
    c(k+'_r3_repeat',k,{},{},[],[],'-','null: same kind of motion, new seeds')
    c(k+'_r3_noise',k,{},dict(noise=1),[],[],'-','null: white encoder noise of one quantum rms added') if False else c(k+'_r3_noise',k,dict(ENCN=.7*p['ENCQ']),{},[],[],'-','null: white encoder noise of 0.7 quantum rms added')
    c(k+'_r3_slow',k,{},dict(course='slow'),[],[],'-','null: slow motion only')
    c(k+'_r3_coulomb',k,dict(FC=1.4*p['FC']),{},[R+'friction.coulomb'],[],'+40 %','')
    c(k+'_r3_mass',k,dict(M=1.08*p['M']),{},['drive.velocity_controller' if vel else 'gantry.inertia'],[],'+8 %','')
    c(k+'_r3_delay',k,dict(DELAY=1.5/M2[k]['fs']),{},[R+'delay'],[R+'lag1',R+'current_loop'],'%.4g s'%(1.5/M2[k]['fs']),'')
write_cases([(nm,mk,M2[mk],*rest) for nm,mk,*rest in C2],3,170500)
