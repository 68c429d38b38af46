#include <math.h>
#include <stdlib.h>
#include <string.h>
enum {M,FC,FV,FQ,DC,DV,FS,VS,SD,PD,K,Q0,F0,G,RA,RP,RPH,KL,PFA,PFL,THC,THT,GAIN,DB,USAT,SLEW,DELAY,LAG,SAG,ML,F2,Z2,ENCLOAD,GAP,EK,EHI,ELO,M1,
 MODE,GN,KE,KP,KI,K3,BF,BQ,BW,XA,XF,EDF,EDV,ENCQ,ENCN,CKP,CKD,FFA,FFV,FFC,UMAX,VFIL,UN,QI,RA2,NPAR};
static double gs(void){static int h=0;static double s;if(h){h=0;return s;}double u=(rand()+1.0)/(RAND_MAX+2.0),w=(rand()+1.0)/(RAND_MAX+2.0);double r=sqrt(-2*log(u));s=r*sin(2*M_PI*w);h=1;return r*cos(2*M_PI*w);}
int npar(void){return NPAR;}
static double sg(double x){return (x>0)-(x<0);}
/* MODE 0 force-like (g), 1 voltage, 2 velocity setpoint */
void sim(const double*P,int seed,int n,int ns,double Tc,const double*rq,const double*rv,const double*ra,double*ou,double*oq,double*ov){
 srand(seed);double dt=Tc/ns,q=P[QI]+rq[0],v=0,q2=q,v2=0,z=0,lagx=0,sl=0,I=0,vm=0,qp=q,t=0,sagf=1;
 int nd=(int)(P[DELAY]/dt+0.5);double*ring=calloc(nd+1,sizeof(double));int ri=0;
 double ph=2*M_PI*rand()/(double)RAND_MAX;double kb=P[ML]*pow(2*M_PI*P[F2],2),cb=2*P[Z2]*2*M_PI*P[F2]*P[ML];
 for(int i=0;i<n;i++){
  double qm=(P[ENCLOAD]>0.5&&P[ML]>0)?q2:q;double vt=(P[ENCLOAD]>0.5&&P[ML]>0)?v2:v;
  qm+=P[ENCN]*gs();if(P[ENCQ]>0)qm=P[ENCQ]*floor(qm/P[ENCQ]+0.5);
  if(i)vm+=P[VFIL]*((qm-qp)/Tc-vm);qp=qm;
  double u;
  if(P[MODE]==2)u=rv[i]+P[CKP]*(rq[i]-qm);
  else{double F=P[FFA]*ra[i]+P[FFV]*rv[i]+P[FFC]*tanh(rv[i]/(1e-9+P[VS]))+P[CKP]*(rq[i]-qm)+P[CKD]*(rv[i]-vm);u=F/P[GN];if(P[MODE]==1)u+=P[KE]*rv[i];}
  if(u>P[UMAX])u=P[UMAX];if(u<-P[UMAX])u=-P[UMAX];
  ou[i]=u+P[UN]*gs();oq[i]=qm;ov[i]=vt;
  for(int s=0;s<ns;s++){
   double x=u;
   if(P[DB]>0)x=fabs(x)<P[DB]?0:x-P[DB]*sg(x);
   x*=P[GAIN];
   if(P[USAT]>0){if(x>P[USAT])x=P[USAT];if(x<-P[USAT])x=-P[USAT];}
   if(P[SLEW]>0){double d=x-sl,m=P[SLEW]*dt;sl+=d>m?m:(d<-m?-m:d);x=sl;}
   if(nd){ring[ri]=x;ri=(ri+1)%(nd+1);x=ring[ri];}
   if(P[LAG]>0){lagx+=dt/P[LAG]*(x-lagx);x=lagx;}
   double F;
   if(P[MODE]==2){double e=x-v;I+=e*dt;F=P[KP]*e+P[KI]*I;}
   else if(P[MODE]==1){double xv=x*sagf;F=P[GN]*(xv-P[KE]*v);if(P[SAG]>0){double i_=F/P[KE];double pw=xv*i_;if(pw<0)pw=0;sagf=1-P[SAG]*pw;}}
   else F=P[GN]*x;
   double Fm=F;
   F+=-P[FV]*v-P[FQ]*v*fabs(v)-P[K]*(q-P[Q0])-P[K3]*pow(q-P[Q0],3)+P[F0]-P[G]*sin(q)+P[RA]*sin(2*M_PI*q/P[RP]+P[RPH])+P[RA2]*sin(4*M_PI*q/P[RP]+1.1)+P[XA]*sin(2*M_PI*P[XF]*t+ph);
   if(P[EK]>0){if(q>P[EHI])F-=P[EK]*(q-P[EHI]);if(q<P[ELO])F+=P[EK]*(P[ELO]-q);}
   if(P[BF]!=0){double y=(q-P[BQ])/P[BW];F-=P[BF]*y*exp(0.5-y*y*0.5);}
   if(P[EDF]>0){double y=v/P[EDV];F-=P[EDF]*2*y/(1+y*y);}
   double mm=P[M];
   if(P[M1]!=0){mm+=P[M1]*q;F-=0.5*P[M1]*v*v;}
   if(P[ML]>0){double d=q-q2,b=P[GAP]/2;double fb=0;if(P[GAP]>0){if(d>b)fb=kb*(d-b)+cb*(v-v2);else if(d<-b)fb=kb*(d+b)+cb*(v-v2);}else fb=kb*d+cb*(v-v2);
     F-=fb;mm-=P[ML];v2+=dt*fb/P[ML];q2+=dt*v2;
     if(P[GAP]>0){double f2=0.15*P[FC]*dt/P[ML];v2=fabs(v2)<=f2?0:v2-sg(v2)*f2;}}
   double sv=v!=0?sg(v):sg(F);
   double L=P[FC]+0.5*(P[DV]*v*0+P[DC]*sv)+0.5*P[DV]*v;
   if(P[FS]>0)L+=P[FS]*exp(-pow(fabs(v)/P[VS],P[SD]));
   L+=P[KL]*fabs(Fm);if(P[PFA]!=0)L+=P[PFA]*sin(2*M_PI*q/P[PFL]);
   if(P[THC]!=0)L+=P[THC]*(1-exp(-t/P[THT]));
   if(L<0)L=0;
   if(P[PD]>0){z=(z+dt*v/P[PD])/(1+dt*fabs(v)/P[PD]);v+=dt*(F-L*z)/mm;}
   else{double v1=v+dt*F/mm,d=dt*L/mm;v=fabs(v1)<=d?0:v1-sg(v1)*d;}
   q+=dt*v;t+=dt;
  }
 }
 free(ring);
}
