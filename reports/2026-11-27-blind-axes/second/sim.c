#include <math.h>
#include <stdlib.h>
#include <string.h>
/* p: parameters by index, see sim.py */
enum{M_,FC,FV,OFF,KIND,KT,R_,KE,LE,KPV,KIV,KP,KD,TAUV,RES,SN,DT,
 FS_,VS_,ASYC,ASYV,DAHL,SPR,ESK,ESL,ESH,RA,RP,RPH,KL,PA,PL,PS,DBD,SAT,SLEW,DELAY,LAG,FQ,THC,THT,TMR,TMF,TMZ,MP1,GA,GO,FFM,FFV,NPAR};
static double rnd(unsigned long long*s){double a=0;for(int i=0;i<12;i++){*s=*s*6364136223846793005ULL+1442695040888963407ULL;a+=(double)(*s>>11)/9007199254740992.0;}return a-6;}
int sim(const double*p,const double*r,const double*rd,const double*rdd,int n,double Tc,unsigned long long seed,double*oq,double*ou,double*otrue){
 double dt=p[DT];int sub=(int)lround(Tc/dt);dt=Tc/sub;int kind=(int)p[KIND];
 double q=r[0],v=0,ql=q,vl=0,z=0,I=0,cur=0,ulag=0,rs=0,qm1=q,vf=0;int first=1;
 double M=p[M_];int nd=(int)lround(p[DELAY]/dt);double*buf=calloc(nd+1,sizeof(double));int bi=0;
 double i0=0; /* start in equilibrium */
 for(int k=0;k<n;k++){
  double qm=p[RES]*floor((q+p[SN]*rnd(&seed))/p[RES]+0.5);
  if(first){qm1=qm;first=0;}
  double vd=(qm-qm1)/Tc;qm1=qm;vf+=(vd-vf)*Tc/(p[TAUV]+Tc);
  double u;
  if(kind==2){u=rd[k]+p[KP]*(r[k]-qm);}
  else{ double F=p[KP]*(r[k]-qm)+p[KD]*(rd[k]-vf)+p[FFM]*rdd[k]+p[FFV]*rd[k]+p[GA]*cos(r[k]-p[GO])*(p[FFM]>0);
   if(kind==0)u=F/p[KT]; else u=F*p[R_]/p[KT]+p[KE]*rd[k];}
  if(k==0){ulag=u;for(int i=0;i<=nd;i++)buf[i]=u;rs=u; if(kind==1)cur=u/p[R_];}
  oq[k]=qm;ou[k]=u;otrue[k]=q;
  for(int s=0;s<sub;s++){
   double t=k*Tc+s*dt,ua=u;
   if(nd>0){double o=buf[bi];buf[bi]=ua;bi=(bi+1)%nd;ua=o;}
   if(p[LAG]>0){ulag+=(ua-ulag)*dt/p[LAG];ua=ulag;}
   if(p[SLEW]>0){double d=ua-rs,m=p[SLEW]*dt;rs+=d>m?m:d<-m?-m:d;ua=rs;}
   if(p[SAT]>0){if(ua>p[SAT])ua=p[SAT];if(ua<-p[SAT])ua=-p[SAT];}
   if(p[DBD]>0){ua=fabs(ua)<p[DBD]?0:ua-copysign(p[DBD],ua);}
   double F;
   if(kind==0)F=p[KT]*ua;
   else if(kind==1){cur+=dt*(ua-p[R_]*cur-p[KE]*v)/p[LE];F=p[KT]*cur;}
   else{double e=ua-v;I+=p[KIV]*e*dt;F=p[KPV]*(e+I);}
   F-=p[OFF];
   double Fd=F;
   double Mq=M;
   if(p[MP1]!=0){Mq=M+p[MP1]*q;F-=0.5*p[MP1]*v*v;}
   F-=p[SPR]*q; F-=p[GA]*cos(q-p[GO]);
   if(p[ESK]>0){if(q<p[ESL])F+=p[ESK]*(p[ESL]-q);if(q>p[ESH])F-=p[ESK]*(q-p[ESH]);}
   if(p[RA]!=0)F+=p[RA]*sin(2*M_PI*q/p[RP]+p[RPH]);
   F-=p[FV]*v+p[FQ]*v*fabs(v);
   double lev=p[FC],av=fabs(v);
   double th=p[THT]>0?1-exp(-t/p[THT]):0; lev+=p[THC]*th;
   if(p[FS_]>0)lev+=p[FS_]*exp(-av/p[VS_]);
   lev+=p[KL]*fabs(Fd);
   if(p[PL]>0)lev+=p[PA]*sin(2*M_PI*q/p[PL]);
   lev+=p[PS]*q;
   double Mm=Mq;
   if(p[TMR]>0){double w=2*M_PI*p[TMF],al=w*w*(q-ql)+2*p[TMZ]*w*(v-vl);Mm=(1-p[TMR])*Mq;F-=p[TMR]*Mq*al;vl+=al*dt;ql+=vl*dt;}
   if(p[DAHL]>0){z+=dt*(v-av*z)/p[DAHL];F-=lev*z+0.0*v;v+=dt*F/Mm;}
   else{double vn=v+dt*F/Mm;
    double sg=vn>0?1:-1;double l=lev+0.5*p[ASYC]*sg+0.5*p[ASYV]*fabs(vn)*sg;if(l<0)l=0;
    double m=dt*l/Mm; v=fabs(vn)<=m?0:vn-copysign(m,vn);}
   q+=v*dt;
   if(!isfinite(q)){free(buf);return 1;}
  }
 }
 free(buf);return 0;}
