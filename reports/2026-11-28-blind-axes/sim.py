"""Independent axis simulator: semi-implicit Euler with implicit rigid Coulomb friction, substeps of a sample."""
import numpy as np, math
def ptp(fs, moves, jerk=0.0, lead=0.3):
    """trapezoids: (dist, vmax, acc, dwell) -> r, rd, rdd at fs; velocity smoothed over `jerk` s"""
    v=[np.zeros(int(lead*fs))]
    for d,vm,a,dw in moves:
        s=math.copysign(1,d); d=abs(d)
        if d<vm*vm/a: vm=math.sqrt(d*a)
        tr=vm/a; tc=d/vm-tr
        t=np.arange(0,2*tr+tc,1/fs)
        p=np.minimum(np.minimum(a*t,vm),np.maximum(a*(2*tr+tc-t),0))
        v.append(s*p); v.append(np.zeros(int(dw*fs)))
    v=np.concatenate(v+[np.zeros(int(0.3*fs))])
    n=int(jerk*fs)
    if n>1: v=np.convolve(v,np.ones(n)/n)[:len(v)]
    r=np.concatenate([[0],np.cumsum((v[1:]+v[:-1])/2)])/fs
    return r,v,np.gradient(v)*fs
def multisine(fs,T,comps,fade=0.5):
    t=np.arange(0,T,1/fs); r=sum(a*np.sin(2*np.pi*f*t+p) for a,f,p in comps)
    w=np.clip(np.minimum(t,T-t)/fade,0,1); w=w*w*(3-2*w); r=r*w
    return r,np.gradient(r)*fs,np.gradient(np.gradient(r)*fs)*fs
def cat(*s):
    out=[];off=0
    for r,v,a in s: out.append((r-r[0]+off,v,a)); off=out[-1][0][-1]
    return tuple(np.concatenate(x) for x in zip(*out))
def force_axis(fs,sub,ref,M,Fc,Fv,F0=0.,kp=0.,kd=0.,fast=True,extra=None,fric=None,drive=None,umax=1e30,q0=0.,t0=0.,
               openloop=None,load=None,meas=None,ffs=1.0):
    """returns t,u,q. M a = drive(u) + F0 + extra(q,v,t) - (Fc+fric)*sgn - Fv v (+ load: second-mass model with own state).
    fast: the controller runs at each substep (drive at kHz, log decimated); otherwise once per sample (ZOH)"""
    dt=1/(fs*sub); n=len(ref[0]) if openloop is None else len(openloop)
    T=[];U=[];Q=[]; q=q0; v=0.; u=0.; z=[0.]*4
    for k in range(n):
        if openloop is not None: r=rd=rdd=0.; dr=dv=da=0.
        else:
            r,rd,rdd=ref[0][k]+q0,ref[1][k],ref[2][k]
            kk=min(k+1,n-1); dr=(ref[0][kk]+q0-r)/sub; dv=(ref[1][kk]-rd)/sub; da=(ref[2][kk]-rdd)/sub
        for j in range(sub):
            t=t0+k/fs+j*dt
            if j==0 or fast:
                if openloop is not None: u=float(openloop[k])
                else:
                    u=kp*(r-q)+kd*(rd-v)+ffs*(M*rdd+Fv*rd-F0)
                    u=umax if u>umax else -umax if u<-umax else u
            F=u if drive is None else drive(u,v,t,z,dt)
            if j==0: T.append(t);U.append(u if meas is None else meas(u,F));Q.append(q)
            f=F+F0
            if extra is not None: f+=extra(q,v,t)
            if load is not None: f+=load(q,v,z,dt)
            lev=Fc if fric is None else max(0.,Fc+fric(q,v,t,F))
            vf=v+dt*(f-Fv*v)/M; fr=lev*dt/M
            v=vf-fr if vf>fr else vf+fr if vf<-fr else 0.
            q+=v*dt; r+=dr; rd+=dv; rdd+=da
    return np.array(T),np.array(U),np.array(Q)
def velocity_axis(fs,sub,sp,M,kp,ki,Fc,Fv,F0=0.,pre=None,q0=0.,t0=0.):
    """PI speed drive: M a = kp e + ki int e - friction + F0; e = pre(setpoint) - v; setpoint held over the sample"""
    dt=1/(fs*sub); q=q0;v=0.;I=0.;z={}; T=[];U=[];Q=[]
    for k in range(len(sp)):
        s=float(sp[k])
        for j in range(sub):
            t=t0+k/fs+j*dt
            if j==0: T.append(t);U.append(s);Q.append(q)
            w=s if pre is None else pre(s,t,z,dt)
            e=w-v; I+=e*dt
            vf=v+dt*(kp*e+ki*I+F0-Fv*v)/M; fr=Fc*dt/M
            v=vf-fr if vf>fr else vf+fr if vf<-fr else 0.
            q+=v*dt
    return np.array(T),np.array(U),np.array(Q)
def steps(fs,seq,ramp=0.0):
    """(level, seconds); ramp = seconds of linear transition"""
    out=[];p=0.
    for l,s in seq:
        n=int(s*fs); m=int(ramp*fs); x=np.full(n,float(l))
        if m: x[:m]=p+(l-p)*(np.arange(m)+1)/m
        out.append(x);p=l
    return np.concatenate(out)
def chirp(fs,T,f0,f1,a):
    t=np.arange(0,T,1/fs); return a*np.sin(2*np.pi*(f0*t+(f1-f0)*t*t/(2*T)))
